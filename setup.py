# SPDX-FileCopyrightText: 2026 The softbody_ros maintainers
# SPDX-License-Identifier: Apache-2.0
from glob import glob

from setuptools import find_packages, setup

package_name = 'softbody_ros'
BAKE = ['usd-core>=24.8', 'pygltflib>=1.16']
DAE = ['pycollada>=0.7']
ROBOT = ['yourdfpy>=0.0.56']
SIMPLIFY = ['fast-simplification>=0.1.9', 'trimesh>=4.5']
SWEEP = ['dask>=2024.8', 'distributed>=2024.8', 'matplotlib', 'rosbags>=0.10', 'zarr>=3']
VIEWER = ['viser>=1.1,<1.2']

setup(
    name=package_name,
    version='0.1.0',
    description='A soft-body simulator that is a ROS 2 node',
    long_description='Bodies deform by meshless shape matching, live, with every property a '
    'ROS parameter; vertices are published as PointCloud2, the surface as Marker.',
    maintainer='The softbody_ros maintainers',
    maintainer_email='maintainers@softbody-ros.example',
    license='Apache-2.0',
    python_requires='>=3.11',
    packages=find_packages(include=[package_name, package_name + '.*']),
    package_data={'softbody_ros.viewer': ['page.js']},
    data_files=[
        ('share/ament_index/resource_index/packages', ['resource/' + package_name]),
        ('share/' + package_name, ['package.xml']),
        ('share/' + package_name + '/config', sorted(glob('config/*'))),
    ],
    install_requires=[
        # 0.59 is the first one for Python 3.12; 0.68 needs numpy<2.6 and refuses newer ones when
        # it is imported: raise both bounds together
        'numba>=0.61',
        'numpy>=1.26,<2.6',
        'scipy>=1.11',
        'trimesh>=4.0',
        # reads the texture coordinates of meshes for trimesh
        'pillow',
        'pyyaml',
        'tqdm',
    ],
    extras_require={
        # files of the command `bake`: USD and glTF
        'bake': BAKE,
        # mesh files in COLLADA, which trimesh reads with it
        'dae': DAE,
        # what tools/benchmarks compares with, and draws with
        'bench': ['pypbd>=2.2', 'rapier3d>=0.36', 'mujoco>=4.0', 'matplotlib'],
        # the pages of `docs` as a site
        'docs': ['sphinx>=8', 'myst-parser>=4', 'furo'],
        'jazzy': [
            'ros-jazzy-rclpy',
            'ros-jazzy-common-interfaces',
            'ros-jazzy-rmw-fastrtps-cpp',
        ],
        # links of a robot as obstacles: reads URDF, and COLLADA meshes
        'robot': ROBOT,
        # bodies with `simplify_to`: quadric decimation, which trimesh calls from 4.5 on
        'simplify': SIMPLIFY,
        # many runs, on one machine or a cluster: the commands `sweep` and `fit`
        'sweep': SWEEP,
        'test': [
            'pytest>=7.4',
            'pytest-xdist>=3.5',
            'hypothesis',
            # builds the workspace that a test runs as `ros2 run` would
            'colcon-common-extensions',
            'setuptools<80',
            # real CAD meshes to load: watertight and not, 5 000 to 70 000 triangles
            'cookie-description==1.2.1',
            *BAKE,
            *DAE,
            *ROBOT,
            *SIMPLIFY,
            *SWEEP,
            *VIEWER,
            # drives Chromium, which is not a Python package: apt-get install chromium
            'playwright',
        ],
        # the page of the command `viewer`
        'viewer': VIEWER,
    },
    entry_points={
        'console_scripts': [
            'sim_node = softbody_ros.__main__:main',
            'bake = softbody_ros.bake.__main__:main',
            'sweep = softbody_ros.ensemble.sweep:main',
            'fit = softbody_ros.ensemble.fit:main',
            'viewer = softbody_ros.viewer.__main__:main',
        ]
    },
    zip_safe=True,
)
