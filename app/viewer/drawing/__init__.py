"""The picture of the page: scene, cameras, rendering and sending."""
