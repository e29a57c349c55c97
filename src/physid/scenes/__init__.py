"""What stands on the ground, how it is pushed, and which parameters are unknown."""

from physid.scenes.catalogue import SETUPS as SETUPS
from physid.scenes.catalogue import find_setup as find_setup
from physid.scenes.parameters import bodies_of as bodies_of
from physid.scenes.parameters import given_in as given_in
from physid.scenes.parameters import with_parameters as with_parameters
from physid.scenes.scene import Body as Body
from physid.scenes.scene import Ground as Ground
from physid.scenes.scene import Integration as Integration
from physid.scenes.scene import Scene as Scene
from physid.scenes.setup import Excitation as Excitation
from physid.scenes.setup import Setup as Setup
