"""How do recordings come from ROS and go there? MCAP and bags, without ROS itself."""
