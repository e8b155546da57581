"""What a project keeps on the disk, and how it survives crashes."""
