#version 330 core
// The projector's light on the wall: bands filtered over the pixel, strut, housing, fall-off and shadow.
// SHADOWED, JAGGED, PRINTED, HOUSED, GLASS or WATER (either: BENT) and FINISHED are defined where they matter: in software GL a branch not taken costs
// as if it were.
const float PI = 3.14159265358979;

in vec3 from_projector;
in vec3 normal_projector;
in vec3 world;
#ifdef BENT
in vec3 wall_projector;
in vec3 came;
in vec2 passed;
#endif
#ifdef GLASS
in vec3 ghost_projector;
in vec3 ghost_came;
#endif
#ifdef WATER
in vec3 sight_from;
in vec3 water_projector_place;
in vec3 water_came;
in vec3 bounces;
in float water_passed;
uniform vec4 water_projector;       // surface: upward normal, how far along that it lies
uniform vec4 water_world;
uniform float bore_radius;          // the water lies within
#endif

uniform sampler2D slide;            // by tangent of the half angle: light summed up to there (rgb), nearest edge (a)
uniform vec4 slide_range;           // tangents of the first texel and from texel to texel, of the first and the last light
uniform vec4 strut;                 // azimuth, half width, softness, rad; slide jag, rad
uniform float slide_cells;          // of the jag, around the slide
uniform vec4 falloff;               // distance power, angle power, reference range, housing radius, mm
uniform mat4 camera_projector;      // projector to camera
uniform vec4 extent;                // radius below which nothing is shaded, radius beyond which is no wall; start, end of the pipe
uniform vec4 crop;                  // shadow map: centre of its tangent plane, half its side
uniform vec4 depth_range;           // shadow map: nearest, farthest, texels, bias in mm
uniform sampler2D shadow_map;
uniform vec4 finish;                // gloss, its power, translucency, its spread in mm
uniform vec3 unpainted;             // one over the wall's reflectance
uniform sampler2D print;            // the rig's own jaggedness, rad (r): a row a slit, a column a cell of the azimuth

out vec4 color;

float hashed(uint edge, uint cell)
{
    uint h = edge * 0x9E3779B1u + (cell % uint(slide_cells)) * 0x85EBCA6Bu;
    h ^= h >> 16u;
    h *= 0x7FEB352Du;
    h ^= h >> 15u;
    h *= 0x846CA68Bu;
    h ^= h >> 16u;
    return float(h >> 8u) / 8388608.0 - 1.0;
}

float slide_place(float tangent)
{
    return clamp((tangent - slide_range.x) / slide_range.y, 0.0, float(textureSize(slide, 0).x - 2));
}

vec3 summed_light(float tangent)
{
    float at = slide_place(tangent);
    int texel = int(at);
    return mix(texelFetch(slide, ivec2(texel, 0), 0).rgb, texelFetch(slide, ivec2(texel + 1, 0), 0).rgb, at - float(texel));
}

uint nearest_edge(float tangent)
{
    return uint(texelFetch(slide, ivec2(int(slide_place(tangent) + 0.5), 0), 0).a);
}

float slit_jag(float tangent, float azimuth)
{
    uint edge = nearest_edge(tangent);
    ivec2 size = textureSize(print, 0);
    int slit = int(edge + 1u) / 2 - 1;
    if (slit < 0 || slit >= size.y) return 0.0;
    float place = azimuth / (2.0 * PI) * float(size.x) - 0.5;
    float cell = floor(place);
    int first = int(cell) + size.x;
    float here = texelFetch(print, ivec2(first % size.x, slit), 0).r;
    return mix(here, texelFetch(print, ivec2((first + 1) % size.x, slit), 0).r, place - cell);
}

float jag(float tangent, float azimuth)
{
    uint edge = nearest_edge(tangent);
    float place = (azimuth / (2.0 * PI) + 0.5) * slide_cells;
    float cell = floor(place);
    return strut.w * mix(hashed(edge, uint(cell)), hashed(edge, uint(cell) + 1u), place - cell);
}

float lit_texel(ivec2 texel, float depth)
{
    float stored = texelFetch(shadow_map, clamp(texel, ivec2(0), ivec2(int(depth_range.z) - 1)), 0).r;
    float near = depth_range.x, far = depth_range.y;
    float occluder = near * far / (far - stored * (far - near));
    return depth - depth_range.w <= occluder ? 1.0 : 0.0;
}

float lit(vec3 place)
{
    vec2 at = ((place.xy / place.z - crop.xy) / crop.z * 0.5 + 0.5) * depth_range.z - 0.5;
    if (any(lessThan(at, vec2(0.0))) || any(greaterThan(at, vec2(depth_range.z - 1.0)))) return 1.0;
    ivec2 texel = ivec2(floor(at));
    vec2 part = at - vec2(texel);
    float left = mix(lit_texel(texel, place.z), lit_texel(texel + ivec2(0, 1), place.z), part.y);
    float right = mix(lit_texel(texel + ivec2(1, 0), place.z), lit_texel(texel + ivec2(1, 1), place.z), part.y);
    return mix(left, right, part.x);
}

bool in_housing(vec3 place)
{
    vec3 apex = camera_projector[3].xyz;
    vec3 seen = (camera_projector * vec4(place, 1.0)).xyz;
    if (apex.z >= 0.0 || seen.z <= 0.0) return false;
    return length(mix(apex.xy, seen.xy, apex.z / (apex.z - seen.z))) < falloff.w;
}

#ifdef FINISHED
vec3 eye()
{
#ifdef WATER
    return sight_from;
#else
    return -transpose(mat3(camera_projector)) * camera_projector[3].xyz;
#endif
}

float mirrored_share(vec3 came, vec3 point, vec3 normal, vec3 eye)
{
    vec3 look = normalize(point - eye), half_way = normalize(-normalize(came) - look);
    float facets = finish.x + (1.0 - finish.x) * pow(1.0 + dot(half_way, look), 5.0);
    float spread = 0.125 * (finish.y + 2.0) * pow(max(dot(half_way, normal), 0.0), finish.y);
    return facets * spread / max(-dot(normal, look), 0.05);
}
#endif

// `place` is where the wall seems to be, `came` how light comes to it, `side` -1 for light from the tube's far side,
// `straight` whether it comes from the projector without a mirror
vec3 thrown_back(vec3 place, vec3 came, float side, bool straight, vec3 point, vec3 normal, vec3 eye, vec3 along_right, vec3 along_down)
{
    vec3 dark = vec3(0.0);
    float across = length(place.xy);
    float tangent = across / place.z;
    if (place.z <= 0.0 || tangent < slide_range.z || tangent > slide_range.w) return dark;
    float range = length(place);
    float facing = -dot(normal, came) / length(came);
    if (facing <= 0.0) return dark;
    float azimuth = atan(place.x, -place.y);
    float visible = 1.0;
    if (strut.y > 0.0) {
        float turn = azimuth - strut.x;
        turn -= 2.0 * PI * round(turn / (2.0 * PI));
        visible = clamp((abs(turn) - strut.y) / max(strut.z, 1e-6) + 0.5, 0.0, 1.0);
    }
    if (visible <= 0.0) return dark;
#ifdef HOUSED
    if (in_housing(place)) return dark;
#endif
#ifdef SHADOWED
    if (straight && length(world.xy) > extent.x) visible *= lit(place);
#endif
    vec3 gradient = vec3(side * place.xy / across, -tangent) / place.z;
    float footprint = max(length(vec2(dot(gradient, along_right), dot(gradient, along_down))), 1e-6);
    float shift = 0.0, slope = 1.0 + tangent * tangent;
#ifdef JAGGED
    shift = jag(tangent, azimuth);
#endif
#ifdef PRINTED
    shift -= slit_jag(tangent, azimuth);
#endif
    tangent += shift * slope;
    vec3 light = (summed_light(tangent + 0.5 * footprint) - summed_light(tangent - 0.5 * footprint)) / footprint;
#ifdef FINISHED
    vec3 mirror = light * unpainted * mirrored_share(came, point, normal, eye);
    float per_mm = sqrt(max(dot(gradient, gradient) - pow(dot(gradient, normal), 2.0), 0.0));
    float wide = length(vec2(footprint, 3.4641016 * finish.w * per_mm));
    vec3 under = (summed_light(tangent + 0.5 * wide) - summed_light(tangent - 0.5 * wide)) / wide;
    light = mix(light, under, finish.z) + (finish.x > 0.0 ? mirror / pow(facing, falloff.y) : dark);
#endif
    return light * visible * pow(facing, falloff.y) * pow(falloff.z / range, falloff.x);
}

#ifdef WATER
vec3 turned_over(vec3 way)
{
    return way - 2.0 * dot(water_projector.xyz, way) * water_projector.xyz;
}
#endif

void main()
{
    // derivatives first: they are undefined behind a branch
#ifdef BENT
    vec3 along_right = dFdx(wall_projector), along_down = dFdy(wall_projector);
#else
    vec3 along_right = dFdx(from_projector), along_down = dFdy(from_projector);
#endif
    vec3 normal = normalize(normal_projector), from = vec3(0.0);
#ifdef FINISHED
    from = eye();
#endif
    color = vec4(0.0, 0.0, 0.0, 1.0);
    if (length(world.xy) > extent.y || world.z < extent.z || world.z > extent.w) return;
#ifdef WATER
    vec3 by_water = vec3(0.0);
    float above = dot(water_world.xyz, world) - water_world.w;
#ifdef UNDER
    if (above >= 0.0) discard;
#else
#ifdef MIRRORED
    if (above < 0.0) discard;
#endif
    color.a = above < 0.0 ? 0.0 : 1.0; // what is below the surface shows the water
    if (above < 0.0) return;
    vec3 image = wall_projector - 2.0 * (dot(water_projector.xyz, wall_projector) - water_projector.w) * water_projector.xyz;
    vec3 from_image = from - 2.0 * (dot(water_projector.xyz, from) - water_projector.w) * water_projector.xyz;
    if (length(bounces.xy) < bore_radius)
        by_water = water_passed * thrown_back(water_projector_place, water_came, 1.0, false, image, turned_over(normal),
            from_image, turned_over(along_right), turned_over(along_down));
#endif
#endif
#ifdef BENT
    color.rgb = passed.x * thrown_back(from_projector, came, 1.0, true, wall_projector, normal, from, along_right, along_down)
#ifdef GLASS
#ifndef UNDER
        + passed.y * thrown_back(ghost_projector, ghost_came, -1.0, false, wall_projector, normal, from, along_right, along_down)
#endif
#endif
#ifdef WATER
        + by_water
#endif
        ;
#else
    color.rgb = thrown_back(from_projector, from_projector, 1.0, true, from_projector, normal, from, along_right, along_down);
#endif
}
