"""From a shape's description to a mesh whose bodies and sides have names."""
