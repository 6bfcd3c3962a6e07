"""What ``case.yaml`` and ``expected.yaml`` say, read and checked before anything is replayed."""
