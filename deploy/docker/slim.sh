#!/bin/sh
# Takes out of an environment what no service of a market loads: slim.sh FOLDER
set -eu
cd "$1"/lib/python3*/site-packages

# Tests, sources and headers of others.
find . -type d -name tests -prune -exec rm -rf {} +
find . -type f \( -name '*.pyi' -o -name '*.pyx' -o -name '*.pxd' -o -name '*.pxi' -o -name '*.h' -o -name '*.cc' \) -delete
rm -rf numpy/f2py numpy/_core/lib numpy/_core/include

# Of plotly, the page needs the script alone.
find plotly -mindepth 1 -maxdepth 1 ! -name __init__.py ! -name package_data -exec rm -rf {} +
find plotly/package_data -mindepth 1 -maxdepth 1 ! -name plotly.min.js -exec rm -rf {} +

# Of Arrow, tables, CSV and Parquet: no servers, no clouds. Its linker names are copies of the libraries.
rm -rf pyarrow/include pyarrow/src
rm -f pyarrow/libarrow_flight* pyarrow/libarrow_python_flight* pyarrow/_flight* pyarrow/flight.py \
    pyarrow/_substrait* pyarrow/libarrow_s3* pyarrow/_s3fs* \
    pyarrow/_pyarrow_cpp_tests* pyarrow/libarrow_python*.so

# Symbols are for debuggers. Libraries in *.libs were edited when their wheel was made, and strip would break them.
find . -type d -name '*.libs' -prune -o -type f -name '*.so*' -exec strip --strip-unneeded {} +
