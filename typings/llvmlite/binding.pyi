from enum import IntEnum

class Linkage(IntEnum):
    internal = 8
    linkonce_odr = 3

def get_host_cpu_name() -> str: ...
