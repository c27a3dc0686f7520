"""Studies of vehicles: a manoeuvre in many worlds that differ by chance, and a search for the best design."""
