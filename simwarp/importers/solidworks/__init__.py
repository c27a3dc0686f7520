"""SolidWorks: what the Chrono add-in exports as a Python script, read and never run."""
