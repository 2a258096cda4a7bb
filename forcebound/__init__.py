"""Force feedback over a network, without ROS, that provably stays passive."""
