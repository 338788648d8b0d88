"""Pictures of bodies, contacts and histories."""
