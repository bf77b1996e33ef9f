"""How is it followed? Trackers that know when they are lost."""
