"""Where the links of a robot are, and which joints bring them there."""
