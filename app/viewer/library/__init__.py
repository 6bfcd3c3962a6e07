"""A page that lists the cases of a folder, opens one in the replay page, and takes uploads."""
