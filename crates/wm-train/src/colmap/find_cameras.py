"""Finds the cameras of photos with pycolmap, by the command line of COLMAP as far as it is used here.

find_cameras.py feature_extractor|exhaustive_matcher|sequential_matcher|mapper|image_undistorter [--NAME VALUE]...
"""

import sys

import pycolmap


def on_cpu(new, old):
    """Returns the argument that says where features are found or matched: its name changed with pycolmap 3.13."""
    name, kind = (new if hasattr(pycolmap, new[1]) else old)
    options = getattr(pycolmap, kind)()
    if hasattr(options, "use_gpu"):
        options.use_gpu = False
    return {name: options, "device": pycolmap.Device.cpu}


command, given = sys.argv[1], dict(zip(sys.argv[2::2], sys.argv[3::2]))
database, photos = given.get("--database_path"), given.get("--image_path")
if command == "feature_extractor":
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = given["--ImageReader.camera_model"]
    has_one_camera = given["--ImageReader.single_camera"] == "1"
    pycolmap.extract_features(
        database_path=database,
        image_path=photos,
        camera_mode=pycolmap.CameraMode.SINGLE if has_one_camera else pycolmap.CameraMode.AUTO,
        reader_options=reader,
        **on_cpu(("extraction_options", "FeatureExtractionOptions"), ("sift_options", "SiftExtractionOptions")),
    )
elif command in ("exhaustive_matcher", "sequential_matcher"):
    run = pycolmap.match_sequential if command == "sequential_matcher" else pycolmap.match_exhaustive
    options = on_cpu(("matching_options", "FeatureMatchingOptions"), ("sift_options", "SiftMatchingOptions"))
    run(database_path=database, **options)
elif command == "mapper":
    # Writes each model to a folder with its number.
    pycolmap.incremental_mapping(database_path=database, image_path=photos, output_path=given["--output_path"])
elif command == "image_undistorter":
    pycolmap.undistort_images(
        output_path=given["--output_path"],
        input_path=given["--input_path"],
        image_path=photos,
        output_type=given["--output_type"],
    )
else:
    sys.exit(f"no command of COLMAP: {command}")
