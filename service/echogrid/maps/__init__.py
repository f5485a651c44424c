"""What stored maps become: pictures, ROS map_server files, npz, merged maps. docs/maps.md."""
