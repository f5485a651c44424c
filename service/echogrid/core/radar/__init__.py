"""What a radar measured and from where: mounts, whole scans, what stands and what moves."""
