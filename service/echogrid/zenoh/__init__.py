"""Who receives it over Zenoh, under which keys: subscribers, ROS 2 nodes, fleets, queries."""
