"""What moves: state, control, contacts, steps, snapshots, diagnostics, and what may take part in a step."""
