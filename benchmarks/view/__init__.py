"""Frame rate and delay of the page in a browser: `marginguard bench view`."""
