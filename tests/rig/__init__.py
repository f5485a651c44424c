"""The service on real CAN interfaces and under a real systemd. What runs depends on the environment variable RIG:

not set     `make test`: test_can.py, in a guest where this machine's own kernel has no vcan for us
full        `make test-rig`: test_systemd.py too, in a guest that systemd boots
guest       inside the guest
here        `make test-rig RIG=here`, as root: all on this machine itself, whose PID 1 is systemd; installs and purges the package

With `guest` and `here` nothing is skipped for want of interfaces.
"""
