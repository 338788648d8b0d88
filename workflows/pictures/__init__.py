"""Pictures and animations of bodies, contacts and histories."""
