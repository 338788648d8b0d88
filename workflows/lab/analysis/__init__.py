"""Small dense models of the published methods, for studies and tests; no scene is solved with them."""
