#version 330 core
// The projector's light on the wall: bands filtered over the pixel, strut, housing, fall-off and shadow.
// SHADOWED, JAGGED and HOUSED are defined where they matter: in software GL a branch not taken costs as if it were.
const float PI = 3.14159265358979;

in vec3 from_projector;
in vec3 normal_projector;
in vec3 world;

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

float jag(float tangent, float azimuth)
{
    uint edge = uint(texelFetch(slide, ivec2(int(slide_place(tangent) + 0.5), 0), 0).a);
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

void main()
{
    // derivatives first: they are undefined behind a branch
    vec3 along_right = dFdx(from_projector), along_down = dFdy(from_projector);
    color = vec4(0.0, 0.0, 0.0, 1.0);
    vec3 place = from_projector;
    float across = length(place.xy);
    float tangent = across / place.z;
    if (place.z <= 0.0 || tangent < slide_range.z || tangent > slide_range.w) return;
    float rho = length(world.xy);
    if (rho > extent.y || world.z < extent.z || world.z > extent.w) return;
    float range = length(place);
    float facing = -dot(normalize(normal_projector), place) / range;
    if (facing <= 0.0) return;
    float azimuth = atan(place.x, -place.y);
    float visible = 1.0;
    if (strut.y > 0.0) {
        float turn = azimuth - strut.x;
        turn -= 2.0 * PI * round(turn / (2.0 * PI));
        visible = clamp((abs(turn) - strut.y) / max(strut.z, 1e-6) + 0.5, 0.0, 1.0);
    }
    if (visible <= 0.0) return;
#ifdef HOUSED
    if (in_housing(place)) return;
#endif
#ifdef SHADOWED
    if (rho > extent.x) visible *= lit(place);
#endif
    vec3 gradient = vec3(place.xy / across, -tangent) / place.z;
    float footprint = max(length(vec2(dot(gradient, along_right), dot(gradient, along_down))), 1e-6);
#ifdef JAGGED
    tangent += jag(tangent, azimuth) * (1.0 + tangent * tangent);
#endif
    vec3 light = (summed_light(tangent + 0.5 * footprint) - summed_light(tangent - 0.5 * footprint)) / footprint;
    color.rgb = light * visible * pow(facing, falloff.y) * pow(falloff.z / range, falloff.x);
}
