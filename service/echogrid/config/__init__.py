"""What a configuration file may say, and what is wrong with one. docs/configuration.md."""
