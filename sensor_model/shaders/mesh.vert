#version 330 core
// Places the wall in the picture through the Kannala-Brandt fisheye and hands on where it is as seen by the projector;
// with DEPTH, only as the projector sees it, cropped to the places that can be shaded. GLASS: all by way of the tube.
// WATER: the wall above it; with MIRRORED as the water mirrors it; with UNDER the wall below it.
layout(location = 0) in vec3 position;
#ifndef DEPTH
layout(location = NORMAL_LOC) in vec3 normal;
#endif
layout(location = INST_M_LOC) in mat4 inst_m;

uniform mat4 M;                 // chunk to world: shifted to the camera's distance, and turned in a bend
uniform mat4 V;                 // world to camera (z forward, x right, y down); with DEPTH, to the projector

// BENT is either of these two.
#ifdef BENT
float reflected(float cosine, float eta)
{
    float behind = sqrt(max(1.0 - eta * eta * (1.0 - cosine * cosine), 0.0));
    float across = (eta * cosine - behind) / (eta * cosine + behind);
    float along = (cosine - eta * behind) / (cosine + eta * behind);
    return 0.5 * (across * across + along * along);
}

#endif

#ifdef GLASS
uniform mat4 tube_projector;    // projector to tube
uniform mat4 tube_camera;       // camera to tube
uniform vec4 tube;              // inner and outer radius, index, ghost
const int TOWARDS_STEPS = 3;

vec3 left(vec3 origin, vec3 direction, float radius)
{
    float a = dot(direction.xy, direction.xy), b = dot(origin.xy, direction.xy);
    float c = dot(origin.xy, origin.xy) - radius * radius;
    return origin + (-b + sqrt(b * b - a * c)) / a * direction;
}

vec3 bent(vec3 direction, vec2 out_of, float eta, inout float passed)
{
    float cosine = dot(direction.xy, out_of);
    float inside2 = 1.0 - eta * eta * (1.0 - cosine * cosine);
    passed *= 1.0 - reflected(cosine, eta);
    return vec3(eta * direction.xy + (sqrt(max(inside2, 0.0)) - eta * cosine) * out_of, eta * direction.z);
}

vec3 through(vec3 origin, vec3 direction, out vec3 onward, out float passed)
{
    passed = 1.0;
    vec3 first = left(origin, direction, tube.x);
    vec3 inside = bent(direction, first.xy / tube.x, 1.0 / tube.z, passed);
    vec3 last = left(first, inside, tube.y);
    onward = bent(inside, last.xy / tube.y, tube.z, passed);
    return last;
}

// Where a point outside seems to be from inside, at its own distance, as `glass.towards` has it; whence light comes to it.
vec3 aimed(mat4 to_tube, vec3 point, out vec3 source, out float passed)
{
    vec3 origin = to_tube[3].xyz, p = (to_tube * vec4(point, 1.0)).xyz, aim = normalize(p - origin), onward;
    vec3 place = through(origin, aim, onward, passed);
    for (int i = 0; i < TOWARDS_STEPS; ++i) {
        aim = normalize(aim + normalize(p - place + length(place - origin) * onward) - onward);
        place = through(origin, aim, onward, passed);
    }
    mat3 back = transpose(mat3(to_tube));
    source = back * (place - origin);
    return back * aim * length(point);
}
#endif

#ifdef WATER
uniform vec4 water_projector;   // the water's surface: upward normal, and how far along that it lies; in the projector's axes
uniform vec4 water_camera;      // in the camera's
uniform vec4 water;             // index, absorption per mm
const int CROSSING_STEPS = 6, ENTERING_STEPS = 3;

float above(vec4 surface, vec3 place)
{
    return dot(surface.xyz, place) - surface.w;
}

float mirrors(vec4 surface, vec3 way)
{
    return reflected(abs(dot(surface.xyz, way)) / length(way), 1.0 / water.x);
}

// As `water.crossing` has it; a place above the water is its own.
vec3 crossing(vec4 surface, vec3 origin, vec3 point)
{
    float high = above(surface, origin), deep = -above(surface, point);
    if (deep <= 0.0) return point;
    vec3 foot = origin - high * surface.xyz, way = point + deep * surface.xyz - foot;
    float across = max(length(way), 1e-6), n2 = water.x * water.x, tangent = across / (high + deep / water.x);
    for (int i = 0; i < CROSSING_STEPS; ++i) {
        float root = sqrt(n2 + (n2 - 1.0) * tangent * tangent);
        tangent += (across - high * tangent - deep * tangent / root) / (high + deep * n2 / (root * root * root));
    }
    return foot + min(high * tangent / across, 1.0) * way;
}

// Where a place in the water seems to be, at its own distance; where the light to it enters.
vec3 aimed_under(vec4 surface, mat4 to_tube, vec3 point, out vec3 enters, out float passed)
{
    vec3 start = vec3(0.0), seems = crossing(surface, start, point);
    enters = seems;
    passed = 1.0;
#ifdef GLASS
    for (int i = 0; i < ENTERING_STEPS; ++i) {
        seems = aimed(to_tube, enters, start, passed);
        enters = crossing(surface, start, point);
    }
#endif
    passed *= exp(-water.y * length(point - enters)) * (1.0 - mirrors(surface, enters - start));
    return normalize(seems) * length(point);
}
#endif

#ifdef BENT
// Where a place in the air seems to be, at its own distance; where the light to it begins to go straight.
vec3 aimed_dry(mat4 to_tube, vec3 point, out vec3 source, out float passed)
{
#ifdef GLASS
    return aimed(to_tube, point, source, passed);
#else
    source = vec3(0.0);
    passed = 1.0;
    return point;
#endif
}

#ifndef GLASS
const mat4 tube_projector = mat4(1.0), tube_camera = mat4(1.0);
#endif
#endif

#ifdef DEPTH

uniform mat4 P;

void main()
{
    vec3 place = (V * (M * inst_m * vec4(position, 1.0))).xyz;
#ifdef BENT
    vec3 source;
    float passed;
#ifdef WATER
    place = above(water_projector, place) < 0.0 ? aimed_under(water_projector, tube_projector, place, source, passed)
        : aimed_dry(tube_projector, place, source, passed);
#else
    place = aimed_dry(tube_projector, place, source, passed);
#endif
#endif
    gl_Position = P * vec4(place, 1.0);
}

#else

uniform mat4 projector_world;   // world to projector
uniform vec4 lens;              // fx, fy, cx, cy, px
uniform vec4 lens_k;            // k1 .. k4
uniform vec4 picture;           // skew, width, height, largest range

out vec3 from_projector;
out vec3 normal_projector;
out vec3 world;
#ifdef BENT
out vec3 wall_projector;        // the place itself; from_projector is where it seems to be
out vec3 came;                  // how light comes to it
out vec2 passed;                // share on the way out and back, and of the ghost
#endif
#ifdef WATER
uniform mat4 camera_projector;  // projector to camera
out vec3 sight_from;            // whence it is seen, in the projector's axes
out vec3 water_projector_place; // where its mirror image in the water seems to be
out vec3 water_came;            // how light comes to that
out vec3 bounces;               // where on the water, in the pipe's axes
out float water_passed;

vec3 to_projector(vec3 place)
{
    return transpose(mat3(camera_projector)) * (place - camera_projector[3].xyz);
}

vec3 mirrored(vec4 surface, vec3 place)
{
    return place - 2.0 * above(surface, place) * surface.xyz;
}

// Where the camera sees a place.
vec3 seen_by_water(vec3 place, out float share)
{
    vec3 source;
#ifdef UNDER
    place = aimed_under(water_camera, tube_camera, place, source, share);
    share /= water.x * water.x;
    sight_from = to_projector(source);
#else
#ifdef MIRRORED
    vec3 image = mirrored(water_camera, place);
    place = aimed_dry(tube_camera, image, source, share);
    share *= mirrors(water_camera, image - source);
    sight_from = to_projector(mirrored(water_camera, source));
#else
    place = aimed_dry(tube_camera, place, source, share);
    sight_from = to_projector(source);
#endif
#endif
    return place;
}

void lit_by_water(vec3 point, float seen)
{
    vec3 source;
    wall_projector = point;
#ifdef UNDER
    from_projector = aimed_under(water_projector, tube_projector, point, source, passed.x);
#else
    from_projector = aimed_dry(tube_projector, point, source, passed.x);
#endif
    came = point - source;
    passed = vec2(seen * passed.x, 0.0);
    vec3 image = mirrored(water_projector, point);
    water_projector_place = aimed_dry(tube_projector, image, source, water_passed);
    water_came = image - source;
    water_passed *= seen * mirrors(water_projector, water_came);
    vec3 at = source + above(water_projector, source) / dot(-water_projector.xyz, water_came) * water_came;
    bounces = transpose(mat3(projector_world)) * (at - projector_world[3].xyz);
}
#endif
#ifdef GLASS
out vec3 ghost_projector;       // where it seems to be by way of the far side of the tube
out vec3 ghost_came;

void by_way_of_glass(vec3 point, float seen)
{
    vec3 source;
#ifndef WATER
    wall_projector = point;
    from_projector = aimed(tube_projector, point, source, passed.x);
    came = point - source;
    passed.x *= seen;
#endif
    vec3 o = tube_projector[3].xyz, p = (tube_projector * vec4(point, 1.0)).xyz;
    float rho = length(p.xy);
    mat3 back = transpose(mat3(tube_projector));
    vec3 ghost = vec3(-(rho + 2.0 * tube.x) / rho * p.xy, p.z) - o;
    float once = reflected(length(ghost.xy) / length(ghost), 1.0 / tube.z), both = 2.0 * once / (1.0 + once);
    ghost_projector = back * ghost;
    ghost_came = back * vec3(length(ghost.xy) / rho * p.xy, ghost.z);
    passed.y = seen * tube.w * both * (1.0 - both);
}
#endif

void main()
{
    vec4 place = M * inst_m * vec4(position, 1.0);
    world = place.xyz;
    from_projector = (projector_world * place).xyz;
    normal_projector = mat3(projector_world) * (mat3(M) * normal);
    vec3 seen = (V * place).xyz;
#ifdef BENT
    vec3 source, point = from_projector;
    float share;
#ifdef WATER
    seen = seen_by_water(seen, share);
    lit_by_water(point, share);
#else
    seen = aimed_dry(tube_camera, seen, source, share);
#endif
#ifdef GLASS
    by_way_of_glass(point, share);
#endif
#endif
    float rho = length(seen.xy);
    float angle = atan(rho, seen.z);
    float a2 = angle * angle;
    float bent = angle * (1.0 + a2 * (lens_k.x + a2 * (lens_k.y + a2 * (lens_k.z + a2 * lens_k.w))));
    vec2 ray = rho > 0.0 ? bent / rho * seen.xy : vec2(0.0);
    vec2 pixel = vec2(lens.x * ray.x + picture.x * ray.y, lens.y * ray.y) + lens.zw;
    vec2 clip = 2.0 * (pixel + 0.5) / picture.yz - 1.0;
    // With the range as w, what is interpolated along a bore is right to second order under an equidistant lens.
    // The picture's first row is the buffer's first, so nothing is flipped when it is read.
    float range = length(seen);
    gl_Position = vec4(clip, 2.0 * range / picture.w - 1.0, 1.0) * range;
}

#endif
