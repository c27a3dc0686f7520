"""``simwarp drive``: one manoeuvre of a vehicle, or many at once, with their files."""
