"""What the paper prints: the numbers of its Tables 2 and 3, typed from NDT & E International 139 (2023) 102936."""

from __future__ import annotations

import numpy as np

DIMENSIONS = ("length", "width", "depth")
TRUE_SIZE_MM = {"length": 70.0, "width": 35.0, "depth": 7.5}

# Table 2: six repeated scans of one defect, mm
TABLE_2_MM = {
    "length": np.array([67.2, 72.3, 67.7, 71.3, 76.6, 66.1]),
    "width": np.array([34.2, 35.7, 33.1, 31.3, 35.2, 32.6]),
    "depth": np.array([5.7, 8.6, 9.4, 4.7, 5.6, 4.8]),
}
TABLE_2_ERR_PCT = (2.3, 1.9, 3.2, 5.4, 4.7, 4.4)  # Eq. 29
TABLE_2_ERROR_PCT = (8.2, 5.1, 8.7, 12.9, 9.0, 12.4)  # Eq. 30

# Table 3: standard and expanded (k = 1.96) uncertainty, mm, and the sizes of the text below it
TABLE_3_STANDARD_MM = {"length": 0.79, "width": 0.54, "depth": 0.62}
TABLE_3_EXPANDED_MM = {"length": 1.55, "width": 1.05, "depth": 1.22}
TABLE_3_MEAN_MM = {"length": 70.5, "width": 33.7, "depth": 6.1}
TABLE_3_K = 1.96

# Table 4: three measurements of each depth
TABLE_4_LOSS_PCT = (75.0, 50.0, 25.0)
TABLE_4_DEPTH_MM = (5.63, 3.75, 1.88)
TABLE_4_ESTIMATE_MM = (5.2, 2.7, 1.2)
TABLE_4_QUALITY_PCT = (88.5, 72.0, 63.5)  # Eq. 32
