"""Contact operators: from the displacement of surface nodes to relative displacement at the contact points."""
