"""Verification problems as scenes."""
