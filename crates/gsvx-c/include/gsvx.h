/* gsvx: compressed 3D Gaussian splatting scenes. The C interface, for C99 and C++11.
 *
 * A stream is a head and chunks. The head has an index: of each chunk its place in the file, its bounds and its
 * level of detail. A chunk is a part of the scene that decodes alone. Its bytes are layers: the base layer (means,
 * shapes, opacities, base colours), then one layer for each degree of spherical harmonics (SH).
 *
 * To decode a stream of which all bytes are in memory:
 *
 *   1. gsvx_open, then gsvx_give with offset 0 and all bytes.
 *   2. gsvx_get_info: the number of chunks, and the SH degree d.
 *   3. For each chunk: gsvx_decode with d + 1 layers, then gsvx_copy once for each array that is wanted.
 *      Where gsvx_info.levels is above 1, take one level L: the chunks of which gsvx_get_chunk says `level == L` or
 *      `exact`.
 *   4. gsvx_close.
 *
 * To decode a stream that arrives in parts, from a file or a server:
 *
 *   1. gsvx_open. Ask gsvx_needs with 0 layers, fetch that range, pass it to gsvx_give; repeat until the range is
 *      empty. Two requests suffice.
 *   2. gsvx_get_info and gsvx_get_chunk tell what there is and where in space. Chunks of coarse levels come first.
 *   3. For each chunk that is wanted: gsvx_needs, fetch, gsvx_give until the range is empty; gsvx_decode, gsvx_copy.
 *      Base layers alone (layers = 1) show the scene without view dependence; ask for more layers of the same chunk
 *      later. gsvx_forget when no more of it is wanted.
 *
 * A sequence of frames: gsvx_open, gsvx_decode_frame with all bytes, gsvx_copy.
 *
 * Errors. Functions return a gsvx_status. `message`, the last argument, gets one line of text about it; it may be
 * NULL. After an error nothing is written to other results, unless a function says otherwise.
 *
 * Pointers. A struct, a result or a handle is a valid, aligned pointer of its type; no two arguments overlap. NULL is
 * an error unless a function allows it. The library keeps no pointer of the caller's after a call.
 *
 * Threads. There is no global state. Different streams may be used on different threads at once. Calls on one stream
 * wait for each other; as a stream holds one decoded chunk, let one thread at a time decode and copy. To decode chunks
 * of a file on several threads, open the stream once on each.
 *
 * Hostile streams give an error, or Gaussians that mean nothing. The memory of a call is bounded by the bytes that
 * were given and by gsvx_options. Where memory runs out the process ends.
 */


#ifndef GSVX_H
#define GSVX_H

/* Made by cbindgen from crates/gsvx-c/src; a test compares it with the source. */

#include <stddef.h>
#include <stdint.h>

// What became of a call.
typedef enum {
  // It did what it promises.
  GSVX_STATUS_OK = 0,
  // The bytes are no gsvx stream.
  GSVX_STATUS_NOT_GSVX = 1,
  // A stream of another version of the format.
  GSVX_STATUS_VERSION = 2,
  // Bytes that the call needs have not been given. If there are no more, the file is truncated.
  GSVX_STATUS_TRUNCATED = 3,
  // The stream is damaged.
  GSVX_STATUS_DAMAGED = 4,
  // More Gaussians than the limit; see `gsvx_options.max_gaussians`.
  GSVX_STATUS_LIMIT = 5,
  // An argument is a null pointer or out of its range.
  GSVX_STATUS_ARGUMENT = 6,
  // The caller's buffer is too small. Nothing was written to it.
  GSVX_STATUS_BUFFER = 7,
  // The model cannot be encoded.
  GSVX_STATUS_MODEL = 8,
  // A mistake in gsvx. Close the stream: all further calls on it fail.
  GSVX_STATUS_INTERNAL = 9,
} gsvx_status;

// Arrays that `gsvx_copy` writes, Gaussian after Gaussian. `d` is `gsvx_info.sh_degree`. "float" is a 32-bit
// float and "word" a 32-bit unsigned integer, both in the byte order of the machine.
typedef enum {
  // 3 floats: x, y, z.
  GSVX_ARRAY_MEANS = 0,
  // 4 floats: a quaternion w, x, y, z. In exact chunks its length need not be 1.
  GSVX_ARRAY_ROTATIONS = 1,
  // 3 floats: natural logarithms of the standard deviations along the Gaussian's axes.
  GSVX_ARRAY_LOG_SCALES = 2,
  // 1 float: the opacity before the sigmoid.
  GSVX_ARRAY_OPACITY_LOGITS = 3,
  // 3 (d + 1)^2 floats: coefficient after coefficient of the spherical harmonics (SH), each red, green, blue, in
  // the order and with the signs of 3DGS. The first is degree 0: the base colour is 0.5 + 0.28209479 times it. PLY
  // files have degree 0 as f_dc, and as f_rest all further coefficients of red, then of green, then of blue.
  GSVX_ARRAY_SH = 4,
  // 3 floats: standard deviations along the Gaussian's axes.
  GSVX_ARRAY_SCALES = 5,
  // 4 floats: red, green and blue of the base colour in sRGB, which may be outside 0 to 1, and the opacity from
  // 0 to 1.
  GSVX_ARRAY_COLOURS = 6,
  // 6 floats: the covariance xx, xy, xz, yy, yz, zz.
  GSVX_ARRAY_COVARIANCES = 7,
  // 4 bytes: red, green, blue, opacity, each from 0 to 255.
  GSVX_ARRAY_COLOUR_BYTES = 8,
  // 12 bytes, if d >= 1: the 3 coefficients of degree 1, each red, green, blue; -1 to 1 is 0 to 255, 128 is 0.
  // The bytes that are left are 128. Larger coefficients are cut.
  GSVX_ARRAY_SH_BYTES1 = 9,
  // 16 bytes, if d >= 2: the 5 coefficients of degree 2, likewise.
  GSVX_ARRAY_SH_BYTES2 = 10,
  // 24 bytes, if d >= 3: the 7 coefficients of degree 3, likewise.
  GSVX_ARRAY_SH_BYTES3 = 11,
  // 4 words: x, y, z as floats; the opacity from 0 to 1 as a half float. These and the next are the arrays of
  // Spark's ExtSplats.
  GSVX_ARRAY_PACKED_A = 12,
  // 4 words: red and green; blue and the log-scale along x; the log-scales along y and z, all as half floats,
  // the first in the low bits; the rotation as axis (two numbers of 10 bits on an octahedron, u in the low bits)
  // and angle (12 bits, half a turn is 4095).
  GSVX_ARRAY_PACKED_B = 13,
  // 4 words, if d >= 1: coefficients 1 to 4. A coefficient is magnitudes of red, green and blue in 8 bits each
  // from the low bits on, their signs in 3 bits, and an exponent e in 5 bits: the value is
  // magnitude / 255 * 2^(e - 15).
  GSVX_ARRAY_PACKED_SH1 = 14,
  // 4 words, if d >= 2: coefficients 5 to 8.
  GSVX_ARRAY_PACKED_SH2 = 15,
  // 4 words, if d >= 3: coefficients 9 to 12.
  GSVX_ARRAY_PACKED_SH3A = 16,
  // 4 words, if d >= 3: coefficients 13 to 15, and 0.
  GSVX_ARRAY_PACKED_SH3B = 17,
} gsvx_array;

// Coordinate axes. Lengths stay as they are in every one.
typedef enum {
  // As trained and stored: right-handed, x to the right, y down, z forward.
  GSVX_AXES_STORED = 0,
  // Right-handed: x to the right, y up, z backward, as in OpenGL.
  GSVX_AXES_Y_UP = 1,
  // Left-handed: x to the right, y up, z forward.
  GSVX_AXES_UNITY = 2,
  // Left-handed: x forward, y to the right, z up. Unreal's unit is the centimetre; the scene's stays what it
  // is, so a scene in metres is to be scaled by 100.
  GSVX_AXES_UNREAL = 3,
} gsvx_axes;

// A stream of which bytes are given as they arrive, and one decoded chunk of it. `gsvx_open` makes it,
// `gsvx_close` frees it.
typedef struct gsvx_stream gsvx_stream;

// How a stream is decoded. 0 is the default of each option; NULL stands for all defaults.
typedef struct {
  // Axes of all that comes out, bounds included: one of `gsvx_axes`.
  uint32_t axes;
  // Most SH coefficients for each colour channel: 1 (base colours alone), 4, 9 or 16. Layers with more are never
  // asked for. 0 stands for all there are.
  uint32_t max_sh_coefficients;
  // Most Gaussians that a chunk may have. Bounds the memory that a hostile stream can take. 0 stands for as many as
  // take, as floats, 1024 bytes for each byte of the chunk and 64 MiB more, which no trained scene exceeds.
  uint64_t max_gaussians;
} gsvx_options;

// Text that explains a status: one line in UTF-8 that ends in a zero, cut if it is longer.
typedef struct {
  // The text; empty where there is nothing to say.
  char text[512];
} gsvx_message;

// Bytes of the stream from `begin` to before `end`, counted from its first.
typedef struct {
  // The first byte.
  uint64_t begin;
  // The byte behind the last.
  uint64_t end;
} gsvx_range;

// What holds for the whole stream.
typedef struct {
  // Gaussians of the finest level of detail, those of exact chunks included.
  uint64_t gaussians;
  // Bytes of the whole stream. A shorter file is truncated, even if what was asked for is all there.
  uint64_t bytes;
  // Number of chunks, of all levels of detail: from the coarsest to the finest, then exact chunks.
  uint64_t chunks;
  // Number of levels of detail, 1 or more. Level 0 is the finest.
  uint32_t levels;
  // SH degree of the arrays, 0 to 3: the stream's, or less if `gsvx_options.max_sh_coefficients` says so.
  uint32_t sh_degree;
  // Least coordinates of the means of the finest level; infinity in a stream without Gaussians. Means of coarse
  // levels may lie outside.
  float low[3];
  // Greatest coordinates of the means of the finest level; minus infinity in a stream without Gaussians.
  float high[3];
  // 1 if the model was trained to be drawn with opacity compensated for the blur of 0.3 square pixels
  // (Mip-Splatting, gsplat's "antialiased"), otherwise 0.
  uint32_t antialiased;
} gsvx_info;

// What the index knows of a chunk: a part of the scene that decodes alone.
typedef struct {
  // Number of its Gaussians.
  uint64_t gaussians;
  // The chunks of the next finer level that together replace this one are `finer_begin`,
  // `finer_begin + 1` ... `finer_end - 1`. Both are 0 in a chunk of the finest level. Exact chunks are in no such
  // range.
  uint64_t finer_begin;
  // See `finer_begin`.
  uint64_t finer_end;
  // Least coordinates of the means.
  float low[3];
  // Greatest coordinates of the means.
  float high[3];
  // Level of detail: 0 is the finest. 0 for an exact chunk too.
  uint32_t level;
  // 1 if its Gaussians are coded bit for bit, otherwise 0. Such a chunk has one layer, with all SH degrees. It
  // belongs to every level of detail: show it beside the chunks of any level.
  uint32_t exact;
  // Number of its layers that are of use: the base layer (means, shapes, opacities, base colours) and one for
  // each SH degree up to `gsvx_info.sh_degree`. Layers of coarse levels may have no bytes.
  uint32_t layers;
} gsvx_chunk;

// A frame that is held, and the sequence that it is of.
typedef struct {
  // Frames of the sequence.
  uint64_t frames;
  // Gaussians of this frame.
  uint64_t gaussians;
  // Frames per second.
  float fps;
  // SH degree of the arrays: see `gsvx_info.sh_degree`.
  uint32_t sh_degree;
} gsvx_frame;

// A model in the parametrisation of 3DGS training. The arrays are as those of `gsvx_array`; they are only read,
// and not after `gsvx_encode` returns. Without Gaussians they may be NULL.
typedef struct {
  // Number of Gaussians.
  uint64_t gaussians;
  // 3 floats for each Gaussian.
  const float *means;
  // 4 floats for each Gaussian: w, x, y, z.
  const float *rotations;
  // 3 floats for each Gaussian: natural logarithms.
  const float *log_scales;
  // 1 float for each Gaussian.
  const float *opacity_logits;
  // 3 (sh_degree + 1)^2 floats for each Gaussian.
  const float *sh;
  // 0 to 3.
  uint32_t sh_degree;
  // One of `gsvx_axes`.
  uint32_t axes;
  // See `gsvx_info.antialiased`.
  uint32_t antialiased;
} gsvx_model;

// What a stream aims for. 0 is the default of each option; NULL stands for all defaults.
typedef struct {
  // If not 0: the best stream of at most so many bytes. `quality` has no effect then.
  uint64_t max_bytes;
  // From above 0 (smallest) to 100 (best); 15 points more make all values twice as precise. 0 stands for 80, where
  // a difference is hard to see.
  float quality;
} gsvx_encode_options;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

// Opens a stream of which no byte is known yet.
//
// `options` may be NULL: see `gsvx_options`. `stream` gets the handle, or NULL if the options are out of their
// ranges (GSVX_STATUS_ARGUMENT).
gsvx_status gsvx_open(const gsvx_options *options,
                      gsvx_stream **stream,
                      gsvx_message *message);

// Frees a stream and all it holds. NULL is allowed. No thread may use the handle during the call or after it.
void gsvx_close(gsvx_stream *stream);

// Gives `size` bytes of the stream, of which the first is number `offset` of the stream. They may come in any order, in
// pieces of any size, asked for or not. A stream in memory is given whole with `offset` 0. The bytes are copied.
//
// GSVX_STATUS_NOT_GSVX, GSVX_STATUS_VERSION or GSVX_STATUS_DAMAGED if the head shows it. All that was given is
// forgotten then, and the stream is as after `gsvx_open`. `gsvx_decode` tells of damage in chunks. Bytes behind the end
// of the stream are ignored. A NULL `bytes` is allowed if `size` is 0.
gsvx_status gsvx_give(gsvx_stream *stream,
                      uint64_t offset,
                      const uint8_t *bytes,
                      size_t size,
                      gsvx_message *message);

// Says which bytes are to be given next: those of the head until it is known, then those that are missing for the
// first `layers` layers of chunk `chunk`, but not for layers that `gsvx_decode` holds already. `range` gets the first
// missing range; `begin` equals `end` when nothing is missing. To read the head alone, pass 0 layers; `chunk` is not
// looked at then, nor before the head is known.
//
// Before the head is known the range may reach beyond the end of a short file: give what there is. A file that has no
// bytes from `begin` on is truncated; only the caller can know.
gsvx_status gsvx_needs(const gsvx_stream *stream,
                       uint64_t chunk,
                       uint32_t layers,
                       gsvx_range *range,
                       gsvx_message *message);

// Tells what holds for the whole stream. GSVX_STATUS_TRUNCATED until the head is known.
gsvx_status gsvx_get_info(const gsvx_stream *stream, gsvx_info *info, gsvx_message *message);

// Tells what the index knows of chunk number `chunk`, from 0 to `gsvx_info.chunks - 1`.
// GSVX_STATUS_TRUNCATED until the head is known.
gsvx_status gsvx_get_chunk(const gsvx_stream *stream,
                           uint64_t chunk,
                           gsvx_chunk *entry,
                           gsvx_message *message);

// Decodes the first `layers` layers of a chunk and holds its Gaussians in place of those held before. `gaussians` gets
// their number, which is `gsvx_chunk.gaussians`; it may be NULL. Fewer layers than there are leave the higher SH
// coefficients 0; numbers of layers beyond what there is stand for all, and 0 for 1. Further layers of a chunk that is
// held are added without decoding the first again.
//
// GSVX_STATUS_TRUNCATED if bytes are missing (see `gsvx_needs`), GSVX_STATUS_DAMAGED if a checksum or a rule of the
// format is broken, GSVX_STATUS_LIMIT if there are too many Gaussians. Nothing is held then. The layers before one that
// is missing or damaged are good: ask for fewer until the call succeeds or 1 fails. After GSVX_STATUS_ARGUMENT what was
// held stays.
gsvx_status gsvx_decode(gsvx_stream *stream,
                        uint64_t chunk,
                        uint32_t layers,
                        uint64_t *gaussians,
                        gsvx_message *message);

// Decodes frame number `number` of a sequence, whose `size` bytes are in memory, and holds its Gaussians in place of those
// held before: gsvx_copy copies them. `frame` gets what they are. Further frames of the
// same group take little time. The work uses all cores, on threads that stay for the next call.
//
// `stream` gives its options, of which `max_gaussians` is the limit of a frame; nothing need be given to it.
// GSVX_STATUS_ARGUMENT if there is no such frame, GSVX_STATUS_VERSION if the stream is none of a sequence,
// GSVX_STATUS_TRUNCATED, GSVX_STATUS_DAMAGED and GSVX_STATUS_LIMIT as in gsvx_decode. What was held stays then.
gsvx_status gsvx_decode_frame(gsvx_stream *stream,
                              const uint8_t *bytes,
                              size_t size,
                              uint64_t number,
                              gsvx_frame *frame,
                              gsvx_message *message);

// The bytes that each Gaussian takes in an array (one of `gsvx_array`) of a stream of SH degree `sh_degree`. 0 for
// what is no array, for degrees above 3, and for arrays of degrees above `sh_degree`.
size_t gsvx_stride(uint32_t array,
                   uint32_t sh_degree);

// Copies an array (one of `gsvx_array`) of the chunk that is held to `out`: as many times `gsvx_stride` bytes as there
// are Gaussians. `size` is what `out` has room for; if that is less, GSVX_STATUS_BUFFER. GSVX_STATUS_ARGUMENT if nothing
// is held. Bytes beyond stay as they are. `out` needs no alignment. The order of the Gaussians is that of the stream, the same in all arrays.
gsvx_status gsvx_copy(const gsvx_stream *stream,
                      uint32_t array,
                      void *out,
                      size_t size,
                      gsvx_message *message);

// Frees the bytes that were given of a chunk. What is held of it stays, and further layers can be added; to decode it
// anew, its bytes must be given again.
gsvx_status gsvx_forget(gsvx_stream *stream,
                        uint64_t chunk,
                        gsvx_message *message);

// Encodes a model. `bytes` and `size` get the stream, which `gsvx_free` frees, or NULL and 0 on an error. `options` may
// be NULL: quality 80. On success the message has what is worth knowing, and is empty if there is nothing.
//
// Gaussians that share a cell of the octree are merged, and their order changes. The work uses all cores, on threads
// that stay for the next call. The same model and options give the same bytes.
//
// GSVX_STATUS_ARGUMENT for a null pointer, an option out of its range, or a `max_bytes` below the smallest stream.
// GSVX_STATUS_MODEL if a number is not finite or too large; the message names the Gaussian.
//
// Libraries that were built without the feature `encode` do not have this function.
gsvx_status gsvx_encode(const gsvx_model *model,
                        const gsvx_encode_options *options,
                        uint8_t **bytes,
                        size_t *size,
                        gsvx_message *message);

// Frees a stream that `gsvx_encode` made. NULL is allowed.
void gsvx_free(uint8_t *bytes, size_t size);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

#endif  /* GSVX_H */
