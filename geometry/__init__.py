"""From the description of a shape to a distributed mesh whose bodies and sides have names."""
