"""What the paper measured, read off its Figures 3 and 4."""

AT = tuple(range(4, 41, 4))  # units
# Figure 4, paper-normalised distance at these lengths, by training length.
FIGURE_4: dict[int, dict[str, tuple[float, ...]]] = {
    8: {
        "gt mixed": (1, 1, 0.983, 0.973, 0.917, 0.839, 0.741, 0.640, 0.550, 0.458),
        "gatv2 mixed": (1, 1, 0.984, 0.971, 0.896, 0.820, 0.739, 0.650, 0.558, 0.474),
        "gcn mixed": (1, 1, 0.983, 0.965, 0.861, 0.788, 0.684, 0.596, 0.519, 0.450),
        "gt full": (1, 1, 0.985, 0.968, 0.914, 0.839, 0.748, 0.650, 0.562, 0.468),
        "gatv2 full": (1, 1, 0.953, 0.875, 0.791, 0.716, 0.642, 0.574, 0.506, 0.436),
        "gcn full": (1, 0.950, 0.893, 0.839, 0.782, 0.717, 0.649, 0.577, 0.507, 0.435),
    },
    16: {
        "gt mixed": (1, 0.995, 0.995, 0.994, 0.990, 0.977, 0.940, 0.884, 0.772, 0.667),
        "gatv2 mixed": (1, 1, 0.997, 0.999, 0.982, 0.951, 0.908, 0.844, 0.731, 0.645),
        "gcn mixed": (1, 0.997, 0.995, 0.996, 0.990, 0.971, 0.938, 0.883, 0.790, 0.693),
        "gt full": (1, 0.998, 0.995, 0.987, 0.985, 0.969, 0.928, 0.877, 0.757, 0.651),
        "gatv2 full": (1, 0.995, 0.956, 0.917, 0.858, 0.784, 0.715, 0.639, 0.554, 0.471),
        "gcn full": (1, 0.945, 0.893, 0.840, 0.785, 0.727, 0.668, 0.608, 0.543, 0.475),
    },
}
# Figure 3, normalised reward at the end of training, by training length.
FIGURE_3: dict[int, dict[str, float]] = {
    8: {
        "gt mixed": 0.96, "gt full": 0.965, "mlp": 0.93, "gcn mixed": 0.90,
        "gatv2 mixed": 0.83, "gatv2 full": 0.83, "gcn full": 0.77,
    },
    16: {
        "gcn mixed": 0.95, "gt full": 0.94, "mlp": 0.94, "gt mixed": 0.94,
        "gatv2 mixed": 0.92, "gcn full": 0.91, "gatv2 full": 0.855,
    },
}  # fmt: skip
