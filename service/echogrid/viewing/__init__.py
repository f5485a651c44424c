"""How does a person see the map, live or recorded? A page in the browser and the small server behind it."""
