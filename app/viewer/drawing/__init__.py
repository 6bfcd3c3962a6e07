"""The picture: a stage, from where it is looked at, drawn and sent as pages have time."""
