"""Reads and checks ``case.yaml`` and ``expected.yaml`` before anything is replayed."""
