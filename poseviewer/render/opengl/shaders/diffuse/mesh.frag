#version 330 core
// Lambert's law in display-encoded values: reflectance (ambient + sum of light max(0, n.l)), and a
// Blinn-Phong highlight of strength metallic_factor. Uniforms are those that pyrender sets.

struct DirectionalLight {
    vec3 color;
    float intensity;
    vec3 direction;
#ifdef DIRECTIONAL_LIGHT_SHADOWS
    sampler2D shadow_map;
    mat4 light_matrix;
#endif
};

struct Material {
    float metallic_factor;
    float roughness_factor;
#ifdef HAS_BASE_COLOR_TEX
    sampler2D base_color_texture;
#endif
};

uniform Material material;
uniform DirectionalLight directional_lights[MAX_DIRECTIONAL_LIGHTS];
uniform int n_directional_lights;
uniform vec3 ambient_light;
uniform vec3 cam_pos;

in vec3 world_position;
in vec3 world_normal;
in vec3 colour;
#ifdef TEXCOORD_0_LOC
in vec2 uv;
#endif

out vec4 frag_color;

#ifdef DIRECTIONAL_LIGHT_SHADOWS
// The share of the light that arrives: nine looks at the shadow map around the point.
float arriving(mat4 light_matrix, sampler2D shadow_map, float cosine)
{
    vec3 place = (light_matrix * vec4(world_position, 1.0)).xyz * 0.5 + 0.5;
    float depth = place.z - mix(0.001, 0.0002, cosine);
    vec2 texel = 1.0 / vec2(textureSize(shadow_map, 0));
    float sum = 0.0;
    for (int x = -1; x <= 1; x++)
        for (int y = -1; y <= 1; y++)
            sum += step(depth, texture(shadow_map, place.xy + texel * vec2(x, y)).r);
    return sum / 9.0;
}
#endif

void main()
{
    vec3 normal = normalize(world_normal) * (gl_FrontFacing ? 1.0 : -1.0);
    vec3 view = normalize(cam_pos - world_position);
    float exponent = 2.0 / pow(max(material.roughness_factor, 0.1), 4.0) - 2.0;
    vec3 diffuse = ambient_light;
    vec3 highlight = vec3(0.0);
    for (int i = 0; i < n_directional_lights; i++) {
        vec3 towards = -normalize(directional_lights[i].direction);
        float cosine = max(dot(normal, towards), 0.0);
        vec3 light = directional_lights[i].intensity * directional_lights[i].color;
#ifdef DIRECTIONAL_LIGHT_SHADOWS
        light *= arriving(
            directional_lights[i].light_matrix, directional_lights[i].shadow_map, cosine);
#endif
        diffuse += light * cosine;
        float peak = max(dot(normal, normalize(towards + view)), 0.0);
        highlight += light * cosine * pow(peak, exponent);
    }
    vec3 reflectance = colour;
#ifdef HAS_BASE_COLOR_TEX
    reflectance *= texture(material.base_color_texture, uv).rgb;
#endif
    frag_color = vec4(
        clamp(reflectance * diffuse + material.metallic_factor * highlight, 0.0, 1.0), 1.0);
}
