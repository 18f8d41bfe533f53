"""Runs one step of COLMAP by the Python package pycolmap, with the arguments of the program colmap."""

import os
import sqlite3
import sys

import pycolmap

# A model that starts with a bad pair ends with few photographs; another seed starts with another.
SEEDS = 3
ENOUGH = 0.75


def map_photographs(database, images, output):
    """Writes models to numbered folders in `output`: those of the first seed, and of the next ones
    until a model has enough of the photographs."""
    photographs = sqlite3.connect(database).execute("SELECT COUNT(*) FROM images").fetchone()[0]
    most = 0
    for seed in range(SEEDS):
        attempt = os.path.join(output, f"seed{seed}")
        os.mkdir(attempt)
        try:
            options = pycolmap.IncrementalPipelineOptions()
            options.random_seed = seed
            models = pycolmap.incremental_mapping(database, images, attempt, options=options)
        except (AttributeError, TypeError):  # before version 4
            models = pycolmap.incremental_mapping(database, images, attempt)
        for name in os.listdir(attempt):
            os.rename(os.path.join(attempt, name), os.path.join(output, f"{name}-{seed}"))
        os.rmdir(attempt)
        most = max([most, *(len(model.images) for model in models.values())])
        if most >= ENOUGH * photographs:
            return
    if most == 0:
        sys.exit("failed to create sparse model")


command = sys.argv[1]
options = dict(zip(sys.argv[2::2], sys.argv[3::2]))
database = options["--database_path"]

if command == "feature_extractor":
    is_single = options["--ImageReader.single_camera"] == "1"
    mode = pycolmap.CameraMode.SINGLE if is_single else pycolmap.CameraMode.AUTO
    model = options["--ImageReader.camera_model"]
    arguments = {"camera_mode": mode, "device": pycolmap.Device.cpu}
    try:
        reader = pycolmap.ImageReaderOptions()
        reader.camera_model = model
        pycolmap.extract_features(database, options["--image_path"], reader_options=reader, **arguments)
    except (AttributeError, TypeError):  # before version 0.5
        pycolmap.extract_features(database, options["--image_path"], camera_model=model, **arguments)
elif command in ("exhaustive_matcher", "sequential_matcher"):
    match = pycolmap.match_exhaustive if command == "exhaustive_matcher" else pycolmap.match_sequential
    arguments = {"device": pycolmap.Device.cpu}
    try:
        geometry = pycolmap.TwoViewGeometryOptions()
        geometry.ransac.random_seed = 0
        match(database, verification_options=geometry, **arguments)
    except (AttributeError, TypeError):  # before version 4
        match(database, **arguments)
elif command == "mapper":
    map_photographs(database, options["--image_path"], options["--output_path"])
else:
    sys.exit(f"unknown step {command}")
