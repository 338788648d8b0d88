"""Pages and tables generated from the code: scene keys, methods, folders."""
