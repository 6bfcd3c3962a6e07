"""What the page says beside the picture: words, numbers, the distance over time."""
