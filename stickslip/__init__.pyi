from stickslip.public import *

VERSION: str
__version__: str
