"""Metrics of the contact surface: approximations of the bodies' flexibility, with secant updates."""
