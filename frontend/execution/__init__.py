"""What runs a scene: its IR, its compiled form for each device, its linear systems."""
