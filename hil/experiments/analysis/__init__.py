"""The statistics of experiments: counts, answers and movements in, estimates out. Pure: no clock, no figure; files are
read as tables of counts and answers alone."""
