"""``simwarp view`` and what else opens the page of the web viewer."""
