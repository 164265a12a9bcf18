"""Files of 3D boxes, brought into the camera frame."""

from eval.box_readers.any_kind import read_boxes
from eval.box_readers.kitti import read_kitti_frames, read_kitti_tracking, read_projection
from eval.box_readers.layers import boxes_of_layers, read_layers
from eval.box_readers.nuscenes import read_nuscenes
from eval.box_readers.ovmono3d import read_category_names, read_ovmono3d
from eval.box_readers.waymo import read_waymo

__all__ = [
    "boxes_of_layers",
    "read_boxes",
    "read_category_names",
    "read_kitti_frames",
    "read_kitti_tracking",
    "read_layers",
    "read_nuscenes",
    "read_ovmono3d",
    "read_projection",
    "read_waymo",
]
