"""Surfaces of links: mesh files and primitive shapes."""
