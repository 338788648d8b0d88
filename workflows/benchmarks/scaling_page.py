"""The page of scaling."""
def page(single, several, drawn):
    return ""
