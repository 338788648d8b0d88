"""The contract of solution methods, and the methods of `auto`, one file each: a class with a NAME adds a method."""
