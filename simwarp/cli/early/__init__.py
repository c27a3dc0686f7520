"""What happens before the imports of a command: refusals of wrong words, and imports that are made lighter."""
