"""RTMPose, DWPose and RTMW in boxes of RTMDet or YOLOX: one file for each family of models."""
