"""Finds the cameras of photos with pycolmap, one step a call, as the commands of COLMAP do.

find_cameras.py extract DATABASE PHOTOS SINGLE|AUTO
find_cameras.py match DATABASE exhaustive|sequential
find_cameras.py map DATABASE PHOTOS MODELS
find_cameras.py undistort PHOTOS MODEL DATASET
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


def extract(database, photos, camera_mode):
    # OPENCV holds the lenses of phones and cameras.
    reader = pycolmap.ImageReaderOptions()
    reader.camera_model = "OPENCV"
    pycolmap.extract_features(
        database_path=database,
        image_path=photos,
        camera_mode=getattr(pycolmap.CameraMode, camera_mode),
        reader_options=reader,
        **on_cpu(("extraction_options", "FeatureExtractionOptions"), ("sift_options", "SiftExtractionOptions")),
    )


def match(database, pairs):
    run = pycolmap.match_sequential if pairs == "sequential" else pycolmap.match_exhaustive
    options = on_cpu(("matching_options", "FeatureMatchingOptions"), ("sift_options", "SiftMatchingOptions"))
    run(database_path=database, **options)


def find_cameras(database, photos, models):
    # Writes each model to a folder with its number.
    pycolmap.incremental_mapping(database_path=database, image_path=photos, output_path=models)


def undistort(photos, model, dataset):
    pycolmap.undistort_images(output_path=dataset, input_path=model, image_path=photos, output_type="COLMAP")


steps = {"extract": extract, "match": match, "map": find_cameras, "undistort": undistort}
steps[sys.argv[1]](*sys.argv[2:])
