"""Roads below vehicles: random ones of ISO 8608, and bitmaps of height, friction and soil.

    road = sw.vehicle.roads.random_road("C", seed=1, x=(-20.0, 300.0), y=(-10.0, 10.0))
    setup = sw.vehicle.set_up(spec, maneuver, road=road)

One surface is what tires, contacts, soil, cameras and lidars meet.
"""

from simwarp.vehicle.roads.road_files import load_road
from simwarp.vehicle.roads.road_surface import RoadSurface, add_road, random_road, road_ground

__all__ = ["RoadSurface", "add_road", "load_road", "random_road", "road_ground"]
