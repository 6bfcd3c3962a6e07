"""What a live session keeps on disk, so that a hold survives its process, and its file locks."""
