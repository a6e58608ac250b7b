# find_package(gsvx) gives the target gsvx::gsvx: the library beside this file's prefix, shared if it is there.
get_filename_component(gsvx_prefix "${CMAKE_CURRENT_LIST_DIR}/../../.." ABSOLUTE)
find_path(gsvx_INCLUDE_DIR gsvx.h PATHS "${gsvx_prefix}/include" NO_DEFAULT_PATH)
find_library(gsvx_LIBRARY gsvx PATHS "${gsvx_prefix}"
  PATH_SUFFIXES lib lib64 "lib/${CMAKE_LIBRARY_ARCHITECTURE}" NO_DEFAULT_PATH)
mark_as_advanced(gsvx_INCLUDE_DIR gsvx_LIBRARY)

include(FindPackageHandleStandardArgs)
find_package_handle_standard_args(gsvx REQUIRED_VARS gsvx_LIBRARY gsvx_INCLUDE_DIR)

if(gsvx_FOUND AND NOT TARGET gsvx::gsvx)
  add_library(gsvx::gsvx UNKNOWN IMPORTED)
  set_target_properties(gsvx::gsvx PROPERTIES
    IMPORTED_LOCATION "${gsvx_LIBRARY}" INTERFACE_INCLUDE_DIRECTORIES "${gsvx_INCLUDE_DIR}")
  # What the static library needs of the system.
  if(UNIX)
    find_package(Threads)
    set_property(TARGET gsvx::gsvx PROPERTY INTERFACE_LINK_LIBRARIES Threads::Threads ${CMAKE_DL_LIBS} m)
  elseif(WIN32)
    set_property(TARGET gsvx::gsvx PROPERTY INTERFACE_LINK_LIBRARIES ws2_32 userenv ntdll bcrypt)
  endif()
endif()
