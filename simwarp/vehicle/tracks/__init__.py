"""Tracks: chains of shoes around sprocket, idler and road wheels."""

from simwarp.vehicle.tracks.laying import LaidChain, TrackCourse, lay_chain

__all__ = ["LaidChain", "TrackCourse", "lay_chain"]
