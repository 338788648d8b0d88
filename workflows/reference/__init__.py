"""Pages written from the code: scene keys, methods, folders."""
