"""Looking recordings over: what is suspicious in them, and the floor."""
