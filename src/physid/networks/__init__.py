"""Images to poses and back: encoder, velocity from poses, renderer, blur."""

from physid.networks.blur import BlurSchedule as BlurSchedule
from physid.networks.blur import GaussianBlur as GaussianBlur
from physid.networks.camera import PinholeCamera as PinholeCamera
from physid.networks.chart import PlanarChart as PlanarChart
from physid.networks.chart import PoseChart as PoseChart
from physid.networks.chart import SpatialChart as SpatialChart
from physid.networks.encoder import Encoder as Encoder
from physid.networks.encoder import Encoding as Encoding
from physid.networks.encoder import PoseEncoder as PoseEncoder
from physid.networks.encoder import VariationalPoseEncoder as VariationalPoseEncoder
from physid.networks.encoder import as_image as as_image
