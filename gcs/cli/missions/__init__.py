"""Commands about missions: as files, and on vehicles."""
