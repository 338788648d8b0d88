"""Semismooth Newton: active sets, and the linear systems of its iterations."""
