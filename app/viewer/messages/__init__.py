"""What an open page may send, and what it is sent."""
