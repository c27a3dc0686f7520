"""What every room may use: value types, arrays, rotations, files, memory, the bridge to torch."""
