"""Pictures of a scene: from where to look, drawn without a screen, as bytes."""
