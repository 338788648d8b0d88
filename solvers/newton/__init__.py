"""Semismooth Newton: active sets, and the linear systems that they lead to."""
