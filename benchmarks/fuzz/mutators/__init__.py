"""Mutations of documents: bytes, text and numbers, lines, JSON, XML, binary fields."""
