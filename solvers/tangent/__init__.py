"""The tangent problem of a step on the whole volume: contact coordinates, its operator, the laws at contact points."""
