"""How is a drive shown to others? Played to subscribers, or in the browser."""
