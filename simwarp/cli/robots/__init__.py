"""Commands for robots of one's own: files read, tasks written for them."""
