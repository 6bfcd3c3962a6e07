"""Pictures of a scene: cameras, rendering without a screen, image files."""
