"""The language, what runs a scene, and the commands; users import its public names from `yasps`."""
