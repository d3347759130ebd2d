"""Close pairs and continuous collision detection."""
