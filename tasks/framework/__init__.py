"""Parts that every task shares: base class, configuration, registry, checks, crash dumps."""
