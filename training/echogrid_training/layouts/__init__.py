"""Which official layouts of data sets with a lidar are read, and what of each becomes a drive that can be labelled?"""
