"""Scripts that a person starts from and changes."""
