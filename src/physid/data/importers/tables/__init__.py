"""Logs of many kinds as named columns of numbers: text, NumPy archives, bags of ROS, data sets of LeRobot."""
