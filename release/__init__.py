"""How is a release made? Its version from tags, its files out of a checkout."""
