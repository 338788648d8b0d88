"""Closed forms and published figures as functions."""
