"""Studies of the published methods in small: nothing here is used to solve a scene."""
