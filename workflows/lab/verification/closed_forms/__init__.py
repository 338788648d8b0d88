"""Closed forms and published figures as functions, with their sources."""
