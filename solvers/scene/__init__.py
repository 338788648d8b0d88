"""What a user says about a scene: frozen data that refuse nonsense."""
