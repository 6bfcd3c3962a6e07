"""Where things are: transform nodes, who moved them, and how old what they show is."""
