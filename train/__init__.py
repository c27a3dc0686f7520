"""Training with rsl-rl; installed and imported as ``simwarp.train``.

The modules are imported by name (``from simwarp.train.training import train``): importing this package alone is cheap.
"""

if __name__ != "simwarp.train":
    # The checkout root on sys.path would load a second copy, with a registry of its own.
    raise ImportError("this folder is imported as simwarp.train: write `import simwarp.train`")
