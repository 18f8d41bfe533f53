"""Runs one step of COLMAP by the Python package pycolmap, with the arguments of the program colmap."""

import sys

import pycolmap

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
elif command == "exhaustive_matcher":
    pycolmap.match_exhaustive(database, device=pycolmap.Device.cpu)
elif command == "sequential_matcher":
    pycolmap.match_sequential(database, device=pycolmap.Device.cpu)
elif command == "mapper":
    models = pycolmap.incremental_mapping(database, options["--image_path"], options["--output_path"])
    if not models:
        sys.exit("failed to create sparse model")
else:
    sys.exit(f"unknown step {command}")
