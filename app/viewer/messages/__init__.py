"""Messages that an open page may send, and those that it is sent."""
