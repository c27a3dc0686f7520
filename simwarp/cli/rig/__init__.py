"""``simwarp rig``: virtual rigs for tires, suspensions, steerings and whole vehicles."""
