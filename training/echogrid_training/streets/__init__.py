"""Where streets run: shapes, habits of a town, the network of streets, OpenStreetMap extracts."""
