"""What users import: scenes, materials, contact, stepping, input and output."""
