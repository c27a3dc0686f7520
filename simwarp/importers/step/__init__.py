"""STEP: solids of CAD programs, without joints."""
