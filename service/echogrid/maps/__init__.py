"""Stored maps: the commands `echogrid map info | show | export | import | merge`. docs/maps.md."""
