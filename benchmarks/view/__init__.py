"""What reaches the browser: pictures a second, and how old they are there."""
