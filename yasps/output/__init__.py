"""What a run shows: files, pictures, animations, progress."""
